"""One mechanism in two descriptions: the descriptions differ, accelerations, reactions and motions must not."""
