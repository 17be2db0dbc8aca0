"""The same impostors as shaders, drawn by an OpenGL driver."""
