"""Data of stillwake's laboratory: a recording and a developed flow; `wake.shipped` knows where they lie."""
