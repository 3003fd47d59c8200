"""The operator panel: one page a task, in a browser, and an OPC UA client like any other.

Every rule (who may approve, nothing moves unapproved) is the server's; the panel asks, shows and repeats what it said.
"""
