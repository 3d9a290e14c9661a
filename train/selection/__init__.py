"""Methods that choose the slim encoder's sensors: the paper's SHAP ranking, and others for comparison."""
