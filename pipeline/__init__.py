"""One study: files, recordings, results, tables, statistics, pictures."""
