"""The store on flash memory whose words can be written once, and a simulated one."""
