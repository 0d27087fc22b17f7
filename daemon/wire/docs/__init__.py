"""The wire's own documents, made from its models."""
