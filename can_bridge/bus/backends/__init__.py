"""What python-can's backends need so that nothing on the wire stops them."""
