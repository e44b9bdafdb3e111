"""Who is who on a bus: certificates, what each may do with them, and what is wrong with them."""
