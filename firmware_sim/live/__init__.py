"""The closed loop on a web page: a session that viewers can change while it runs, its server, and the page."""
