"""HTML and PDF reports of designed mirrors, their tables and the paper's sheets."""
