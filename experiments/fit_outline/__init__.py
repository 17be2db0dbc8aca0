"""How far off is a pose from a silhouette alone, and does the fit say so?"""
