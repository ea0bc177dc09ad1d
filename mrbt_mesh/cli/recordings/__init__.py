"""Commands on recordings: which files are meant, and what is told of them."""
