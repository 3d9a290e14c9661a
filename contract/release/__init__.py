"""Release bundles: container, manifest, signature, and the checks that loading makes."""
