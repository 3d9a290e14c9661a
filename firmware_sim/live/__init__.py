"""The closed loop on a page in a browser: a session that can be acted on while it runs, its server, its page."""
