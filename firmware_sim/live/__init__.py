"""The closed loop on a live web page: a session that viewers can change while it runs, its server, and the page."""
