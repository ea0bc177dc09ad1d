"""`python -m mrbt_mesh` is the command `mrbt`."""

from mrbt_mesh.cli.main import main

if __name__ == "__main__":
    main()
