"""The manual: its pages, the reference that is made from the commands and the schema, search, and the web site."""
