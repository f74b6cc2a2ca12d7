"""``consilience explain``: what a verdict, a term or a trap is, in three lines. Tables, and a page that prints them."""
