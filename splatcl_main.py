"""The `splatcl` command: nothing is imported before an interrupt can be answered, not even the package."""


def main() -> int:
    """Run the command line of splatcl and return the exit status."""
    try:
        from splatcl.cli import main

        return main()
    except KeyboardInterrupt:
        return 130
