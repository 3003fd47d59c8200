"""`opcua-skill`: where the command line begins.

Every worker process runs this file anew before its first computation, so it imports nothing until it is called.
"""

import sys


def main() -> None:
    """Run the command line."""
    from opcua_skill.commands.verbs import status_of

    sys.exit(status_of(sys.argv[1:]))


if __name__ == "__main__":
    main()
