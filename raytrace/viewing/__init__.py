"""Eyes, poses and cameras: from where a reflector is looked at."""
