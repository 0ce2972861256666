"""The report of an identification: what is shown (evidence, findings), and how (figures, page)."""
