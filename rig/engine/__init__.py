"""How a test is executed and made safe."""
