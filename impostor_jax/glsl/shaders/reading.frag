flat in vec4 color;
layout(location = 0) out vec4 drawn;

void main() {
    vec2 off = gl_PointCoord - 0.5;
    if (dot(off, off) > 0.25) discard;
    drawn = color;
}
