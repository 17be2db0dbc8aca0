// Rectangles around an outline, which vertex shaders span by its support functions.
//
// An image is the plane z = 1 or, of parallel rays, z = 0. What is seen of a disc is
// derived in rendering/outline.py.

// Unit vector along v; the x axis where v is zero.
vec2 direction_of(vec2 v) {
    // Its largest component first, so that no square under- or overflows.
    float largest = max(abs(v.x), abs(v.y));
    return largest > 0.0 ? normalize(v / largest) : vec2(1.0, 0.0);
}

// Corner where the outline's tangents across the unit vectors n and m meet.
//
// ahead and beside are the largest n.x and m.x over the outline's points x in the image.
// The whole image where it has no such tangents.
vec4 clip_of_rectangle(
    vec2 corner, vec2 n, float ahead, vec2 m, float beside, bool in_front
) {
    // A driver snaps corners to parts of a pixel, and the support is rounded.
    float margin = 0.25 / min(focal.x, focal.y);
    ahead += margin + 1e-6 * abs(ahead);
    beside += margin + 1e-6 * abs(beside);
    bool tight = in_front
        && max(abs(ahead), abs(beside)) * max(focal.x, focal.y) < 1e6;
    return tight ? clip_of_pixel(focal * (ahead * n + beside * m) + principal)
                 : clip_of_corner(corner);
}

// v.w without the parts along the axis.
float across(vec3 v, vec3 w, vec3 a) {
    return dot(v, w) - dot(v, a) * dot(w, a);
}

#ifdef ORTHOGRAPHIC

bool point_in_front(vec3 p) {
    return true;
}

vec2 seen_point(vec3 p) {
    return p.xy;
}

// Largest n.x over the image x of a disc.
float disc_support(vec2 n, vec3 c, vec3 a, float r) {
    float n_a = dot(n, a.xy);
    return dot(n, c.xy) + r * sqrt(max((1.0 - n_a) * (1.0 + n_a), 0.0));
}

// Direction, in the image, of the direction a at the point c.
vec2 seen_axis(vec3 c, vec3 a) {
    return a.xy;
}

bool disc_in_front(vec3 c, vec3 a, float r) {
    return true;
}

#else

bool point_in_front(vec3 p) {
    return p.z > 0.0;
}

vec2 seen_point(vec3 p) {
    return p.xy / p.z;
}

// Largest n.x over the image x of a disc, from its dual conic.
float disc_support(vec2 n, vec3 c, vec3 a, float r) {
    vec3 normal = vec3(n, 0.0), forward = vec3(0.0, 0.0, 1.0);
    float n_n = across(normal, normal, a), n_z = across(normal, forward, a);
    float z_z = across(forward, forward, a);
    vec3 w = normal * c.z - forward * dot(normal, c);
    float gap = r * r * (across(w, w, a) - r * r * (n_n * z_z - n_z * n_z));
    float scale = c.z * c.z - r * r * z_z;
    return (dot(normal, c) * c.z - r * r * n_z + sqrt(max(gap, 0.0))) / scale;
}

vec2 seen_axis(vec3 c, vec3 a) {
    return a.xy * c.z - c.xy * a.z;
}

bool disc_in_front(vec3 c, vec3 a, float r) {
    return c.z > r * sqrt(max((1.0 - a.z) * (1.0 + a.z), 0.0));
}

#endif
