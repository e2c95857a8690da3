"""The commands of ``mbstab``: each is the function of the name of its module, which is found here by itself."""
