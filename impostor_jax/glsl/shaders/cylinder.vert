// Billboard of a capped cylinder: a rectangle that is tight to its outline.
//
// Camera frame as everywhere else: x right, y down, z forward; lengths in meters. The
// rectangle lies along the axis as it is seen. Its sides come from the support function
// of the outline, the larger of those of the two end discs (rendering/outline.py).

layout(location = 0) in vec3 cylinder_center;
layout(location = 1) in vec3 cylinder_axis;
layout(location = 2) in vec2 cylinder_size;  // radius, height

flat out vec3 center;
flat out vec3 axis;
flat out float radius;
flat out float height;
flat out int index;

#ifdef AS_PUBLISHED

void main() {
    center = cylinder_center;
    axis = cylinder_axis;
    radius = cylinder_size.x;
    height = cylinder_size.y;
    index = gl_InstanceID;
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    // Fault 3: this square cuts off corners, and more in perspective.
    float half_size = max(radius, height / 2.0);
    gl_Position = clip_of_point(center + vec3(corner * half_size, 0.0));
}

#else

// v.w without the parts along the axis.
float across(vec3 v, vec3 w, vec3 a) {
    return dot(v, w) - dot(v, a) * dot(w, a);
}

#ifdef ORTHOGRAPHIC

float disc_support(vec2 n, vec3 c, vec3 a, float r) {
    float n_a = dot(n, a.xy);
    return dot(n, c.xy) + r * sqrt(max((1.0 - n_a) * (1.0 + n_a), 0.0));
}

vec2 seen_axis(vec3 c, vec3 a) {
    return a.xy;
}

bool in_front(vec3 below, vec3 above, vec3 a, float r) {
    return true;
}

#else

// Largest n.x over the image of a disc in the plane z = 1, from its dual conic.
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

bool in_front(vec3 below, vec3 above, vec3 a, float r) {
    float reach = r * sqrt(max((1.0 - a.z) * (1.0 + a.z), 0.0));
    return min(below.z, above.z) > reach;
}

#endif

void main() {
    center = cylinder_center;
    axis = cylinder_axis;
    radius = cylinder_size.x;
    height = cylinder_size.y;
    index = gl_InstanceID;
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;

    vec3 below = center - axis * (height / 2.0), above = center + axis * (height / 2.0);
    vec2 along = seen_axis(center, axis);
    // Its largest component first, so that no square under- or overflows.
    float largest = max(abs(along.x), abs(along.y));
    along = largest > 0.0 ? normalize(along / largest) : vec2(1.0, 0.0);
    vec2 aside = vec2(-along.y, along.x);

    vec2 n = corner.x * along, m = corner.y * aside;
    float ahead = max(disc_support(n, below, axis, radius),
                      disc_support(n, above, axis, radius));
    float beside = max(disc_support(m, below, axis, radius),
                       disc_support(m, above, axis, radius));
    // A driver snaps corners to parts of a pixel, and the support is rounded.
    float margin = 0.25 / min(focal.x, focal.y);
    ahead += margin + 1e-6 * abs(ahead);
    beside += margin + 1e-6 * abs(beside);
    vec2 seen = ahead * n + beside * m;

    bool tight = in_front(below, above, axis, radius)
        && max(abs(ahead), abs(beside)) * max(focal.x, focal.y) < 1e6;
    gl_Position = tight ? clip_of_pixel(focal * seen + principal)
                        : clip_of_corner(corner);
}

#endif
