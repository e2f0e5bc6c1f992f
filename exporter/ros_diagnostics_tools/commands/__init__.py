"""The subcommands of ``ros-diagnostics``, a file each."""
