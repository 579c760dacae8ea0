"""What is C++ in the real package."""
