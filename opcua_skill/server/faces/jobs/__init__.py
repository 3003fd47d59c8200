"""Jobs (OPC 40001-3 with OPC 10031-4 V2): a manufacturing system's orders, each of which becomes one job."""
