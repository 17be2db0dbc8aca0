// Where points and lines of a page are, in front of both their vertex shaders.

uniform mat3 view_from_page;
uniform vec3 eye;   // in the frame of the page
uniform float lift; // meters that a mark counts as nearer: noise must not hide it

vec3 in_view(vec3 place) {
    return view_from_page * (place - eye);
}

// Clip space with the depth as w, so that the hardware leaves out what is behind.
vec4 clip_of_point(vec3 p) {
    vec2 part = (focal * p.xy + (principal + 0.5) * p.z) / image_size;
    float level = 2.0 * window_depth(p.z - lift) - 1.0;
    return vec4(2.0 * part.x - p.z, p.z - 2.0 * part.y, level * p.z, p.z);
}
