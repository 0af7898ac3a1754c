"""The published studies, each as one function that returns its figures."""
