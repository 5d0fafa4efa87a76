"""Targets: what each finger should feel, who owns it and until when, and the paths of virtual fingers."""
