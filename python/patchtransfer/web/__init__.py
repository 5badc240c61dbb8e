"""Results as web pages: one self-contained file each, with pictures one can look into."""
