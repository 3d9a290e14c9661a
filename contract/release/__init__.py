"""Release bundles: container, manifest, signature, and the checks made when a bundle is loaded."""
