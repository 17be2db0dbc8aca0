"""What do the published ways to march over a heightfield cost and miss?"""
