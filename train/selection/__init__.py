"""The methods that choose the slim encoder's sensors: the paper's SHAP ranking, and other methods for comparison."""
