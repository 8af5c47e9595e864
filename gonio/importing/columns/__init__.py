"""What columns of a table say beside their roles: units, readings that come again."""
