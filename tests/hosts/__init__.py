"""A fleet on several hosts: network namespaces with a switch between them. Needs root on Linux."""
