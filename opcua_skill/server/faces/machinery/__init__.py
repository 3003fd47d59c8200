"""Machinery (OPC 40001-1): what a workstation's machine is doing, and what for."""
