"""What happens electrically where the needle stands: contact, pin, soil, circuit, and a meter that measures it."""
