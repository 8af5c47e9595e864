"""Files of renderers: parameters of shading models (glTF, MaterialX), and Radiance's own tables by its own tools."""
