"""The stages of the pipeline: values in, values out; none imports another."""
