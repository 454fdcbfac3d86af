"""The report: one self-contained HTML file in which a person sees a result, trusts it or corrects it."""
