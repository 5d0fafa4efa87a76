"""`hapticd latency`: what each part of the path from report to board takes."""
