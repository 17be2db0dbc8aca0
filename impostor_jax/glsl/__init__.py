"""The same impostor as a shader, drawn by an OpenGL driver, and parity with it."""
