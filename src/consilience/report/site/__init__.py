"""A static site of many reports: an address for every cell, its history, scores over editions, badges."""
