"""Documentation: tables and figures of README and docs, made from committed results."""
