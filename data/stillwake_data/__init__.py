"""Data of stillwake's laboratory: a recording and a developed flow; `contract.shipped` knows where they lie."""
