"""Commands on compact models: training, reduction, judging, families."""
