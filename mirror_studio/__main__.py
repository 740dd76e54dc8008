"""`python -m mirror_studio` is `mirror-cad`."""

from mirror_studio import interrupt


def main() -> None:
    """Run a command; an interrupt ends it in the same way from here on, before anything is imported."""
    interrupt.install()
    from mirror_studio.cli import main as run

    run()


if __name__ == "__main__":
    main()
