// What every fragment does on a page where shapes stand among points: meet its pixel's ray
// with the instance, and shade the surface by a light at the eye.

layout(location = 0) out vec4 drawn;

uniform vec4 color;    // and how much of what is behind is covered
uniform float is_flat; // 1 where the color is a number, which must not be shaded

void main() {
    vec3 o, d;
    ray_of_fragment(gl_FragCoord.xy, o, d);
    Surface seen = intersect(o, d);
    if (seen.t >= INFINITE) discard;
    gl_FragDepth = window_depth(o.z + d.z * seen.t);
    float straight = -dot(seen.normal, normalize(d));
    // Glass covers more where it is looked along.
    float edge = (1.0 - straight) * (1.0 - straight);
    vec4 lit = vec4(color.rgb * (0.45 + 0.55 * straight), mix(color.a, 1.0, 0.6 * edge));
    drawn = mix(lit, color, is_flat);
}
