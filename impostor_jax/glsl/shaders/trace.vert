// The whole image, whose fragments trace a ray each.

void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = clip_of_corner(2.0 * corner - 1.0);
}
