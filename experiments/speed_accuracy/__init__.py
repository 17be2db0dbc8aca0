"""What each dial of an effort costs, and what it gives."""
