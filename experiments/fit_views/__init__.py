"""How much do more views of a can tell, and do fits reach the joint bound?"""
