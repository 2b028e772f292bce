"""The digital twin: from a scene to what the camera would have written."""
