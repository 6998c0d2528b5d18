#version 330 core
// All that the scene requires: Lambert's law for one distant light that shines along the viewing
// direction, on facets seen from either side. No specular term, no shadow, no texture
// (the Blender set-up of roatienza/pc2pix@23b7b46d).
in vec3 eye_position;
#ifdef COLOR_0_LOC
flat in vec3 face_color;
#endif
out vec4 frag_color;

struct Material { vec4 base_color_factor; };
uniform Material material;

const float GAMMA = 2.2;

void main() {
    // The facet's normal from screen-space derivatives: flat shading without normals per vertex.
    vec3 facet = cross(dFdx(eye_position), dFdy(eye_position));
    float area = length(facet);
    // The light comes from +Z in eye space. A facet too small to have a normal counts as facing it.
    float cosine = area > 0.0 ? abs(facet.z) / area : 1.0;
#ifdef COLOR_0_LOC
    vec3 color = face_color;
#else
    vec3 color = material.base_color_factor.rgb;
#endif
    // Light is linear, colours are sRGB (as a pure power law): c^g * cos, back to c * cos^(1/g).
    frag_color = vec4(color * pow(min(cosine, 1.0), 1.0 / GAMMA), 1.0);
}
