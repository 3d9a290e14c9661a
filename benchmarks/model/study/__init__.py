"""The paper's results section and appendices A and C, on the recorded data set: `python -m benchmarks.model.study`."""
