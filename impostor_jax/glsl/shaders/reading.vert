// A reading of a depth image: as large as its pixel is, colored by its residual.

layout(location = 0) in vec3 instance_place;
layout(location = 1) in float instance_residual;  // in meters; infinite where the fit failed
layout(location = 2) in float instance_owner;  // number of the fit that used it, from 1

uniform vec3 taken_from;    // where the camera was
uniform vec2 footprint;     // width of a pixel: at the camera, and more by each meter
uniform float smallest;     // of a point, in pixels
uniform float limit;        // residual of the last color
uniform vec3 scale[5];      // colors of residuals, from -limit to limit
uniform vec3 other;         // of readings that are of no shape
uniform vec3 used;          // and of those of a fit that failed
uniform float is_colored;
uniform float is_flat;      // 1 where the color is the owner's number

flat out vec4 color;

vec3 color_of(float residual) {
    float place = clamp(2.0 + 2.0 * residual / limit, 0.0, 4.0);
    int first = min(int(place), 3);
    return mix(scale[first], scale[first + 1], place - float(first));
}

void main() {
    vec3 p = in_view(instance_place);
    gl_Position = clip_of_point(p);
    float width = footprint.x + footprint.y * distance(instance_place, taken_from);
    gl_PointSize = clamp(1.2 * focal.x * width / max(p.z, 1e-6), smallest, 32.0);
    vec3 seen = other;
    if (instance_owner > 0.5 && is_colored > 0.5) {
        seen = instance_residual > 1e30 ? used : color_of(instance_residual);
    }
    color = vec4(mix(seen, vec3(instance_owner / 255.0, 0.0, 0.0), is_flat), 1.0);
}
