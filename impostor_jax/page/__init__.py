"""Pages for a browser on which a person looks at fits."""
