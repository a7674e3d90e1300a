"""The paper's Fig. 10, overtaking at five values of tau over paired starts."""
