#version 330 core
// All that the scene requires: Lambert's law for one distant light that shines along the viewing
// direction, on facets seen from either side. No specular term, no shadow, no texture
// (the Blender set-up of roatienza/pc2pix@23b7b46d).
in vec3 eye_position;
flat in vec3 face_color;
out vec4 frag_color;

const float GAMMA = 2.2;

void main() {
    // The facet's normal from screen-space derivatives: flat shading without normals per vertex.
    vec3 facet = cross(dFdx(eye_position), dFdy(eye_position));
    float area = length(facet);
    // The light comes from +Z in eye space. A facet too small to have a normal counts as facing it.
    float cosine = area > 0.0 ? abs(facet.z) / area : 1.0;
    // Light is linear, colours are sRGB (as a pure power law): c^g * cos, back to c * cos^(1/g).
    frag_color = vec4(face_color * pow(min(cosine, 1.0), 1.0 / GAMMA), 1.0);
}
