"""TcCOM: modules with identity, interfaces and a life cycle."""
