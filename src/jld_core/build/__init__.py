"""Scene → Assembly: elements, interfaces, materials, loads."""
