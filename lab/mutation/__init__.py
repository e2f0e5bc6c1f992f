"""How many small mistakes, planted at random in a package, its unit tests find."""
