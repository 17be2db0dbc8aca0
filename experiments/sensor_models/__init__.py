"""Do intervals hold on images that are drawn by models of whole cameras?"""
