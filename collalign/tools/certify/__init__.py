"""What is proven about all arrangements of a result's shapes."""
