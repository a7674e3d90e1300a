"""The paper's parametric study of registration (Table I) on a made-up stretch of road, and beyond it."""
