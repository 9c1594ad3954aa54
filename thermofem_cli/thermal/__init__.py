"""Commands on heat and its models: training data, compact models, families."""
