"""The shipped release in the closed loop: tables of what `stillwake run` and `stillwake develop --steady` measured."""
