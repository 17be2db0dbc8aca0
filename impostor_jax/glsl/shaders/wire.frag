// The hardware would interpolate the depth as if it were linear in 1 / z.
in float ahead;
layout(location = 0) out vec4 drawn;

uniform vec4 color;

void main() {
    gl_FragDepth = window_depth(ahead);
    drawn = color;
}
