"""The closed loop shown live on a web page: a session that viewers can change while the loop runs, its server, and the
page."""
