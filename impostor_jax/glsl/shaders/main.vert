// What every vertex does: a corner of the instance's billboard.

void main() {
    take_instance();
    gl_Position = billboard(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0);
}
