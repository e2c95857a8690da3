"""Numbers and linear algebra: ranks, many digits, proven balls, failures of arithmetic."""
