// First crossing of the ray of a pixel with a heightfield over a grid.
//
// The ray goes from patch to patch, in each of which its gap, the height above the
// surface, is a polynomial of the way: of degree 2 over a bilinear patch, 6 over a bicubic
// one. Cut down to the part between where the ray comes in and where it goes out, a patch
// has the gap's Bernstein coefficients as sums of its control points across the ray. They
// tell where there is no root; the first one is solved for, or closed in on.
//
// primitives/heightfield.py crosses the same surface by other means: it skips blocks of
// patches and takes steps that provably do not cross. Fields: center, of the box around
// the surface; rotation, size; patches, their numbers along x and z; is_bicubic; and the
// samples' heights above the center.

const float NONE = 2.0;  // No root in [0, 1].

float height_at(ivec2 place) {
    ivec2 at = clamp(place, ivec2(0), ivec2(patches));
    return sample_at(at.x * (int(patches.y) + 1) + at.y);
}

// Heights at the corners of a patch; columns follow each other along x.
mat2 bilinear_points(ivec2 cell) {
    return mat2(
        height_at(cell), height_at(cell + ivec2(0, 1)),
        height_at(cell + ivec2(1, 0)), height_at(cell + ivec2(1, 1))
    );
}

// Height of a patch and its derivatives along both sides, at a place in [0, 1]^2.
vec3 bilinear_surface(mat2 points, vec2 at) {
    vec2 u = vec2(1.0 - at.x, at.x), v = vec2(1.0 - at.y, at.y), slope = vec2(-1.0, 1.0);
    vec2 along = points * u;
    return vec3(dot(along, v), dot(points * slope, v), dot(along, slope));
}

// Control points of the segments between the middle two of four samples, by Catmull and
// Rom; beyond the border the samples go on straight.
mat4 catmull_rom(mat4 near, bool is_first, bool is_last) {
    if (is_first) near[0] = 2.0 * near[1] - near[2];
    if (is_last) near[3] = 2.0 * near[2] - near[1];
    return mat4(
        near[1], near[1] + (near[2] - near[0]) / 6.0,
        near[2] - (near[3] - near[1]) / 6.0, near[2]
    );
}

mat4 bicubic_points(ivec2 cell) {
    mat4 near;
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 4; j++) near[i][j] = height_at(cell + ivec2(i - 1, j - 1));
    }
    ivec2 last = ivec2(patches) - 1;
    near = transpose(catmull_rom(near, cell.x == 0, cell.x == last.x));
    return transpose(catmull_rom(near, cell.y == 0, cell.y == last.y));
}

vec4 bernstein(float t) {
    float s = 1.0 - t;
    return vec4(s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t);
}

vec4 bernstein_slope(float t) {
    float s = 1.0 - t;
    return 3.0 * vec4(-s * s, s * (s - 2.0 * t), t * (2.0 * s - t), t * t);
}

vec3 bicubic_surface(mat4 points, vec2 at) {
    vec4 v = bernstein(at.y), along = points * bernstein(at.x);
    return vec3(
        dot(along, v), dot(points * bernstein_slope(at.x), v),
        dot(along, bernstein_slope(at.y))
    );
}

vec3 surface(ivec2 cell, vec2 at) {
    if (is_bicubic > 0.5) return bicubic_surface(bicubic_points(cell), at);
    return bilinear_surface(bilinear_points(cell), at);
}

// Control points of the part between a and b, along x, from the polar form.
mat4 part(mat4 p, float a, float b) {
    vec4 a0 = mix(p[0], p[1], a), a1 = mix(p[1], p[2], a), a2 = mix(p[2], p[3], a);
    vec4 b0 = mix(p[0], p[1], b), b1 = mix(p[1], p[2], b), b2 = mix(p[2], p[3], b);
    vec4 aa0 = mix(a0, a1, a), aa1 = mix(a1, a2, a);
    vec4 bb0 = mix(b0, b1, b), bb1 = mix(b1, b2, b);
    return mat4(
        mix(aa0, aa1, a), mix(aa0, aa1, b), mix(bb0, bb1, a), mix(bb0, bb1, b)
    );
}

// First root of a quadratic that begins above 0, or on 0 and leaves it.
float first_root(vec3 b) {
    float fall = b.x - b.y, curvature = b.x - 2.0 * b.y + b.z;
    float discriminant = b.y * b.y - b.x * b.z;
    if (min(b.y, b.z) > 0.0 || discriminant < 0.0) return NONE;
    float root = sqrt(discriminant);
    // Of the two forms of the root, the one that subtracts nothing.
    if (fall > 0.0) return b.x / (fall + root);
    return curvature < 0.0 ? (root - fall) / -curvature : NONE;
}

// Bernstein coefficients of the part of a polynomial after s.
void cut_before(inout float b[7], float s) {
    for (int turn = 6; turn > 0; turn--) {
        for (int k = 0; k < turn; k++) b[k] = mix(b[k], b[k + 1], s);
    }
}

// Those of its first half: of each turn of de Casteljau's the first. (In place, with a loop
// that counts down to a bound of its own, Mesa's drivers get other numbers than WebGL.)
void halve(inout float b[7]) {
    float firsts[7];
    for (int turn = 0; turn < 7; turn++) {
        firsts[turn] = b[0];
        for (int k = 0; k < 6 - turn; k++) b[k] = 0.5 * (b[k] + b[k + 1]);
    }
    b = firsts;
}

// The only root in (0, 1]: Newton's steps, and halves where these leave the bracket.
float only_root(float b[7]) {
    float low = 0.0, high = 1.0, s = b[0] > 0.0 ? b[0] / (b[0] - b[6]) : 0.5;
    for (int turn = 0; turn < 24; turn++) {
        float p[7] = b;
        for (int degree = 6; degree > 1; degree--) {
            for (int k = 0; k < degree; k++) p[k] = mix(p[k], p[k + 1], s);
        }
        float value = mix(p[0], p[1], s), slope = 6.0 * (p[1] - p[0]);
        if (value > 0.0) low = s; else high = s;
        float next = s - value / slope;
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        if (abs(next - s) <= EPS) return next;
        s = next;
    }
    return s;
}

// First root of a polynomial of degree 6 that begins above 0, or on 0 and leaves it.
//
// A stretch without a change of sign among its coefficients has no root, one with a single
// change has one; any other is halved.
float first_root(float whole[7]) {
    float lower = 0.0, width = 1.0, b[7] = whole;
    for (int turn = 0; turn < 128; turn++) {
        b[0] = max(b[0], 0.0);
        if (b[0] == 0.0 && b[1] < 0.0) return lower;
        int changes = 0;
        for (int k = 0; k < 6; k++) changes += (b[k] < 0.0) != (b[k + 1] < 0.0) ? 1 : 0;
        if (changes == 1) return lower + width * only_root(b);
        if (changes == 0) {
            lower += width;
            if (lower >= 1.0) return NONE;
            width = 1.0 - lower;
            b = whole;
            cut_before(b, lower);
        } else {
            // Between two roots the gap is no more than its rounding.
            if (width < 4.0 * EPS) return lower;
            width *= 0.5;
            halve(b);
        }
    }
    return NONE;
}

// Where a ray that is on a side, 1 above or -1 below, first crosses a patch: the part of
// its way from one place in the patch, at the height y.x, to another at y.y.
float first_crossing(ivec2 cell, vec2 from, vec2 to, vec2 y, float side) {
    if (is_bicubic < 0.5) {
        mat2 points = bilinear_points(cell);
        float first = bilinear_surface(points, from).x;
        float last = bilinear_surface(points, to).x;
        float across = 0.5 * (bilinear_surface(points, vec2(from.x, to.y)).x
                            + bilinear_surface(points, vec2(to.x, from.y)).x);
        vec3 b = side * (vec3(y.x, 0.5 * (y.x + y.y), y.y) - vec3(first, across, last));
        return first_root(vec3(max(b.x, 0.0), b.yz));
    }
    mat4 p = transpose(part(bicubic_points(cell), from.x, to.x));
    p = transpose(part(p, from.y, to.y));
    float heights[7] = float[7](
        p[0][0],
        (p[0][1] + p[1][0]) / 2.0,
        (p[0][2] + 3.0 * p[1][1] + p[2][0]) / 5.0,
        (p[0][3] + 9.0 * p[1][2] + 9.0 * p[2][1] + p[3][0]) / 20.0,
        (p[1][3] + 3.0 * p[2][2] + p[3][1]) / 5.0,
        (p[2][3] + p[3][2]) / 2.0,
        p[3][3]
    );
    float b[7];
    for (int k = 0; k < 7; k++) {
        b[k] = side * (mix(y.x, y.y, float(k) / 6.0) - heights[k]);
    }
    return first_root(b);
}

// Unit normal that points upwards, at a place in a patch.
vec3 upward(ivec2 cell, vec2 at) {
    vec2 rise = surface(cell, at).yz * (patches / size.xz);
    return rotation * normalize(vec3(-rise.x, 1.0, -rise.y));
}

Surface intersect(vec3 o, vec3 d) {
    float radius = length(size.xz) / 2.0, foot;
    vec3 near = brought_near(o, d, center, center, radius, foot);
    // In the frame of the field, with x and z counted in patches.
    vec3 p = near * rotation, e = d * rotation;
    Interval x = slab_interval(near, d, rotation[0], size.x / 2.0);
    Interval y = slab_interval(near, d, rotation[1], size.y / 2.0 + radius);
    Interval z = slab_interval(near, d, rotation[2], size.z / 2.0);
    float t = max(max(x.lower, y.lower), max(z.lower, -foot));
    float end = min(min(x.upper, y.upper), z.upper);
    if (!(t <= end)) return MISS;
    vec2 per_meter = patches / size.xz;
    vec2 start = p.xz * per_meter + patches / 2.0, pace = e.xz * per_meter;
    ivec2 last = ivec2(patches) - 1;
    ivec2 cell = clamp(ivec2(floor(start + t * pace)), ivec2(0), last);

    // The side on which the ray begins; on the surface, the side to which it goes.
    vec3 below = surface(cell, start + t * pace - vec2(cell));
    float gap = p.y + t * e.y - below.x, slope = e.y - dot(below.yz, pace);
    float rounding = 2.0 * EPS * (abs(p.y) + abs(t * e.y) + abs(below.x)
        + max(patches.x, patches.y) * (abs(below.y) + abs(below.z)));
    bool on_surface = abs(gap) <= rounding;
    float side = (on_surface ? slope : gap) < 0.0 ? -1.0 : 1.0;
    if (on_surface) p.y -= gap;

    int most = int(patches.x + patches.y);
    for (int turn = 0; turn < most; turn++) {
        vec2 corner = vec2(cell);
        vec2 way = corner + vec2(greaterThan(pace, vec2(0.0))) - start;
        float to_x = pace.x == 0.0 ? INFINITE : way.x / pace.x;
        float to_z = pace.y == 0.0 ? INFINITE : way.y / pace.y;
        float leave = max(t, min(min(to_x, to_z), end));
        vec2 heights = p.y + vec2(t, leave) * e.y;
        // On a border the ray has no way here, and its gap no sign but the next patch's.
        float s = leave > t ? first_crossing(
            cell, start + t * pace - corner, start + leave * pace - corner, heights, side
        ) : NONE;
        if (s <= 1.0) {
            t += s * (leave - t);
            break;
        }
        bool over_x = to_x <= to_z;
        if (over_x) cell.x += pace.x > 0.0 ? 1 : -1;
        else cell.y += pace.y > 0.0 ? 1 : -1;
        if (leave >= end || cell != clamp(cell, ivec2(0), last)) return MISS;
        t = leave;
    }
    return Surface(foot + t, facing(upward(cell, start + t * pace - vec2(cell)), d), 0);
}
