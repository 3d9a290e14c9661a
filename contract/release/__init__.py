"""The release bundles: container, manifest, signature, and the checks that are made when a bundle is loaded."""
