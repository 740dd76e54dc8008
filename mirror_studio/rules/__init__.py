"""What rules of the road ask of a mirror, line by line: rules as data, what is measured of a mirror, and a sheet of both."""
