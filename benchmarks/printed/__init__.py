"""Printed numbers of a publication: strips that give them, and those that no strip can give."""
