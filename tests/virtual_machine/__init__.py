"""Where the virtual machine's numbers come from."""
