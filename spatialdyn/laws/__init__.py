"""Control laws and costs of motions as Specs with values: what a run takes, before there is one."""
