"""A result as a page, pictures, films and figures."""
