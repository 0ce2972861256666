"""Many machines: what each recording tells, which machine changed and when, and what is usual for a type."""
