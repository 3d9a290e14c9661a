"""How the slim encoder's sensors are chosen: by the paper's SHAP ranking, and by other methods for comparison.

`methods.select` is the one door.
"""
