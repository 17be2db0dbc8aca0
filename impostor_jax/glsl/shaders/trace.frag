// Color that the ray of a pixel sees: Lambert, Phong, shadows, mirrors and glass.
//
// Rays, weights and what ends a path are those of rendering/paths.py; what is reflected is
// that of lights.py, and where rays start that of secondary.py. A ray that goes on as two
// leaves the mirrored one on a stack.

layout(location = 0) out vec4 drawn_color;

uniform vec3 background;
uniform ivec2 lights;  // first texel, and how many there are
uniform mat3 turn;     // rays of the camera, turned and moved into the frame of the shapes
uniform vec3 eye;

const float LEAST_WEIGHT = 1.0 / 4096.0;
const int AMBIENT = 0, POINT = 1, INVERSE_SQUARE = 2, DIRECTIONAL = 3;

struct Path {
    vec3 o;
    vec3 d;
    float weight;
    int level;
};

vec3 unit_of(vec3 v) {
    float size = length(v);
    return size > 0.0 ? v / size : vec3(0.0);
}

// Light of intensity 1 that a white surface sends to a viewer, on the way from it.
float reflected(vec3 way, vec3 n, vec3 v, float exponent) {
    vec3 to_light = unit_of(way);
    float n_l = dot(n, to_light), part = max(n_l, 0.0);
    float r_v = dot(n * (2.0 * n_l) - to_light, v);
    if (n_l > 0.0 && r_v > 0.0 && exponent >= 0.0) part += pow(r_v, exponent);
    return part;
}

vec3 lit(vec3 point, vec3 n, vec3 off, vec3 v, float exponent) {
    vec3 total = vec3(0.0);
    for (int k = 0; k < lights.y; k++) {
        vec4 place = number_at(lights.x + 2 * k);
        vec3 intensity = number_at(lights.x + 2 * k + 1).rgb;
        int kind = int(place.w);
        if (kind == AMBIENT) {
            total += intensity;
            continue;
        }
        vec3 start = point + off, way = place.xyz, shadow_way = place.xyz;
        if (kind != DIRECTIONAL) {
            way -= point;
            shadow_way -= start;
        }
        float reach = kind == DIRECTIONAL ? INFINITE : 1.0;
        if (dot(shadow_way, n) > 0.0 && is_blocked(start, shadow_way, reach)) continue;
        float part = reflected(way, n, v, exponent), square = dot(way, way);
        if (kind == INVERSE_SQUARE) part *= square > 0.0 ? 1.0 / square : 0.0;
        total += intensity * part;
    }
    return total;
}

// Vector along the normal by which rays that start at a hit are moved.
vec3 clearance(vec3 o, vec3 way, vec3 n, vec4 anchor) {
    vec3 reach = abs(o) + abs(anchor.xyz) + 2.0 * abs(way);
    return n * (2.0 * EPS * (dot(abs(n), reach) + anchor.w));
}

#ifdef GLASS

// The ray behind a surface, by Snell's law; the part of the light that is mirrored.
vec3 refracted(vec3 d, vec3 n, float ratio, bool by_angle, out float turned) {
    float cos_in = -dot(n, d);
    float square = 1.0 - ratio * ratio * (1.0 - cos_in) * (1.0 + cos_in);
    float cos_out = sqrt(max(square, 0.0));
    turned = cos_out > 0.0 ? 0.0 : 1.0;
    if (by_angle) {
        float across = (ratio * cos_in - cos_out) / (ratio * cos_in + cos_out);
        float along = (cos_in - ratio * cos_out) / (cos_in + ratio * cos_out);
        turned = cos_in > 0.0 ? (across * across + along * along) / 2.0 : 1.0;
    }
    return d * ratio + n * (ratio * cos_in - cos_out);
}

#endif

vec3 color_of(vec3 o, vec3 d) {
    vec3 color = vec3(0.0);
    Path path = Path(o, unit_of(d), 1.0, 0);
#ifdef GLASS
    Path waiting[BOUNCES];
    int height = 0;
    const int CASTS = (2 << BOUNCES) - 1;
#else
    const int CASTS = BOUNCES + 1;
#endif
    for (int cast_rays = 0; cast_rays < CASTS; cast_rays++) {
        Met met = first_met(path.o, path.d);
        bool goes_on = false;
        if (met.place < 0) {
            color += path.weight * background;
        } else {
            vec4 made = number_at(met.place + COLOR), glassy = number_at(met.place + GLASSY);
            vec3 way = path.d * met.surface.t, point = path.o + way, n = met.surface.normal;
            vec3 off = clearance(path.o, way, n, number_at(met.place + ANCHOR));
            bool more = path.level < BOUNCES;
            float back = more ? glassy.x : 0.0, through = more ? glassy.y : 0.0;
            float part = path.weight * (1.0 - back - through);
            vec3 light = lit(point, n, off, -path.d, made.w);
            color += made.rgb * part * light;
            Path mirrored = Path(
                point + off, path.d - n * (2.0 * dot(n, path.d)), 0.0, path.level + 1
            );
#ifdef GLASS
            bool inside = is_inside(met, path.o + path.d * (met.surface.t / 2.0));
            float ratio = inside ? glassy.z : 1.0 / glassy.z, turned;
            vec3 bent = refracted(path.d, n, ratio, glassy.w > 0.0, turned);
            float first = path.weight * through * (1.0 - turned);
            mirrored.weight = path.weight * (back + through * turned);
            bool goes_back = mirrored.weight > LEAST_WEIGHT;
            goes_on = first > LEAST_WEIGHT;
            // What goes on is cast next, and what goes back after it, or next if alone.
            if (goes_on && goes_back) {
                // Written by constant indices: softpipe writes by height for all of its
                // four fragments at once.
                for (int k = 0; k < BOUNCES; k++) if (k == height) waiting[k] = mirrored;
                height++;
            }
            if (goes_on) path = Path(point - off, bent, first, path.level + 1);
            else path = mirrored;
            goes_on = goes_on || goes_back;
#else
            mirrored.weight = path.weight * back;
            path = mirrored;
            goes_on = mirrored.weight > LEAST_WEIGHT;
#endif
        }
#ifdef GLASS
        if (!goes_on && height > 0) {
            height--;
            for (int k = 0; k < BOUNCES; k++) if (k == height) path = waiting[k];
            goes_on = true;
        }
#endif
        if (!goes_on) break;
    }
    return color;
}

#ifdef SCREEN

// What sRGB has for linear light, as in io/color_image.py.
vec3 srgb(vec3 linear) {
    vec3 light = clamp(linear, 0.0, 1.0);
    vec3 curve = 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055;
    return mix(curve, 12.92 * light, lessThanEqual(light, vec3(0.0031308)));
}

#endif

void main() {
    vec3 o, d;
    ray_of_fragment(gl_FragCoord.xy, o, d);
    vec3 color = color_of(eye + turn * o, turn * d);
#ifdef SCREEN
    color = srgb(color);
#endif
    drawn_color = vec4(color, 1.0);
}
