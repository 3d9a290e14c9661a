"""What people use at a bench or a vehicle; some of it needs the extra `bus`, and says so."""
