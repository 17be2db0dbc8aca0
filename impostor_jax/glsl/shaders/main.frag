// What every fragment does: meet its pixel's ray with the instance, and write the surface.

layout(location = 0) out vec4 drawn_position;  // of the surface, and the primitive's index
layout(location = 1) out vec4 drawn_normal;    // and which part of the surface

void main() {
    vec3 o, d;
    ray_of_fragment(gl_FragCoord.xy, o, d);
    Surface seen = intersect(o, d);
    if (seen.t >= INFINITE) discard;
    vec3 p = o + d * seen.t;
    drawn_position = vec4(p, index);
    drawn_normal = vec4(seen.normal, seen.part);
    gl_FragDepth = window_depth(p.z);
}
