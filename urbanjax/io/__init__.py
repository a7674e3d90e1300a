"""The impure rooms: configuration, files, figures, highway-env."""
